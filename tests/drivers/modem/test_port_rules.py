"""The rules that name the rover's ports and keep others off them."""

from __future__ import annotations

import re
from pathlib import Path

HOME = Path(__file__).parents[3]
RULES = (HOME / "systemd" / "60-sprayer-ports.rules").read_text(encoding="utf-8")
LINES = [line for line in RULES.splitlines() if line and not line.startswith("#")]


def test_every_port_of_the_rover_has_a_rule_that_names_it() -> None:
    wanted = set(re.findall(r'"/dev/sprayer-(\w+)"', (HOME / "configs" / "rover.toml").read_text(encoding="utf-8")))
    assert wanted == {"arm", "relay", "gps", "modem", "wheels"}
    assert set(re.findall(r'ENV\{SPRAYER_PORT\}="(\w+)"', "\n".join(LINES))) == wanted


def test_each_rule_is_of_keys_that_match_or_assign() -> None:
    for line in LINES:
        for part in line.split(", "):
            assert re.fullmatch(r'\s*([A-Z]+(\{[\w.]+\})?)\s*(==|!=|\+=|=)\s*"[^"]*"\s*|(LABEL|GOTO)="\w+"', part), part


def test_modem_manager_is_kept_off_our_ports_and_not_off_the_modems_others() -> None:
    assert 'ENV{SPRAYER_PORT}=="?*", ENV{ID_MM_PORT_IGNORE}="1"' in LINES
    (whole_device,) = [line for line in LINES if "ID_MM_DEVICE_IGNORE" in line]
    assert 'ENV{SPRAYER_PORT}!="modem"' in whole_device
