"""A configuration whose production back ends are sent to the ports of an emulated rover."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robot.config.devices import NmeaGpsSection, StereoUsbCameraSection
from robot.config.whole import Config

SERIAL = ("arm", "relay", "inputs", "gps", "modem", "wheels")


def with_ports(config: Config, ports: Mapping[str, str]) -> Config:
    """The same configuration with the ports of ``ports`` (device -> path or address); devices not in it keep theirs."""
    changed: dict[str, Any] = {
        name: getattr(config, name).model_copy(update={"port": ports[name]})
        for name in SERIAL
        if name in ports and getattr(config, name).backend != "mock"
    }
    if isinstance(config.camera, StereoUsbCameraSection) and "camera" in ports:
        changed["camera"] = config.camera.model_copy(update={"device": ports["camera"]})
    gps = changed.get("gps")
    if isinstance(gps, NmeaGpsSection) and gps.ntrip is not None and "ntrip" in ports:
        host, _, port = ports["ntrip"].partition(":")
        ntrip = gps.ntrip.model_copy(update={"host": host, "port": int(port)})
        changed["gps"] = gps.model_copy(update={"ntrip": ntrip})
    return config.model_copy(update=changed)
