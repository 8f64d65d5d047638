"""Over a real socket: who may ask, how, and what a stop does to a shot."""

from __future__ import annotations

import json
import socket
import stat
import threading
import time
from collections.abc import Iterator

import pytest
from prometheus_client.parser import text_string_to_metric_families

from drivers.twin.truth_record import read_truth
from robot.client import ask, find_socket, socket_path
from robot.clock import run_real
from robot.control import ControlSocket
from robot.errors import BusyError, ConfigError, FileError, UnavailableError
from robot.events import Bus
from robot.ledger import LedgerReader, Outcome
from robot.runtime import RunOptions, StopSignals, ledger_path, run_robot
from tests.robot.mission.rover import DEMO, configuration, simulated

from .living import Living, living


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Iterator[Living]:
    """One that is never started; every test leaves it disarmed."""
    with living(tmp_path_factory.mktemp("robot")) as alive:
        yield alive


def raw(robot: Living, data: bytes) -> tuple[int, dict[str, object]]:
    """(status, body) of an answer to bytes as they are; the connection is then closed by the robot."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(10.0)
        connection.connect(str(robot.path))
        connection.sendall(data)
        answer = b""
        while chunk := connection.recv(65536):
            answer += chunk
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split()[1]), json.loads(body) if body else {}


def post_of(verb: str, body: bytes, length: int | None = None) -> bytes:
    size = len(body) if length is None else length
    return f"POST /v1/{verb} HTTP/1.1\r\nHost: robot\r\nContent-Length: {size}\r\n\r\n".encode() + body


def acknowledged(robot: Living) -> None:
    assert robot.post("acknowledge").ok


# --- status and metrics


def test_status_tells_mode_tasks_and_their_rates(robot):
    body = robot.get("/v1/status").body
    assert body["version"] == 1
    assert (body["robot"], body["mode"], body["causes"], body["faults"]) == ("demo-rover", "disarmed", [], [])
    assert body["mission"]["state"] == "idle"
    assert body["ledger"] is None
    tasks = {task["name"]: task for task in body["tasks"]}
    assert {"sensors", "odometry", "arm", "relay", "gps", "modem", "mode log", "frame recorder"} <= set(tasks)
    assert (tasks["sensors"]["owner"], tasks["sensors"]["expected_hz"]) == ("actuation", 10.0)


def test_metrics_are_read_by_prometheus_own_parser(robot):
    robot.until(lambda: 'le="+Inf"} 0.0' not in robot.get("/metrics").body["text"])
    text = robot.get("/metrics").body["text"]
    families = {family.name: family for family in text_string_to_metric_families(text)}
    modes = {sample.labels["mode"]: sample.value for sample in families["sprayer_mode"].samples}
    assert modes["disarmed"] == 1.0
    assert sum(modes.values()) == 1.0
    beats = {sample.labels["task"]: sample.value for sample in families["sprayer_task_beats"].samples}
    assert beats["sensors"] > 0
    lateness = families["sprayer_loop_lateness_seconds"].samples
    bounds = [sample.labels["le"] for sample in lateness if sample.name.endswith("_bucket")]
    assert bounds == ["0.001", "0.002", "0.005", "0.01", "0.02", "0.05", "0.1", "0.25", "1.0", "+Inf"]
    counts = [sample.value for sample in lateness if sample.name.endswith("_bucket")]
    assert counts == sorted(counts)
    assert counts[-1] > 0


def test_the_socket_is_for_its_owner_and_group_only(robot):
    assert stat.S_IMODE(robot.path.stat().st_mode) == 0o660


# --- what is refused, and how


@pytest.mark.parametrize(
    ("method", "place", "status", "words"),
    [
        ("POST", "/v1/amr", 404, "there is no '/v1/amr'; did you mean '/v1/arm'?"),
        ("GET", "/v2/status", 404, "did you mean '/v1/status'?"),
        ("GET", "/v1/stop", 405, "expected POST, found GET"),
        ("POST", "/v1/status", 405, "expected GET, found POST"),
    ],
)
def test_an_unknown_verb_or_method_is_refused_with_the_nearest(method, place, status, words, robot):
    answer = ask(robot.path, method, place)
    assert answer.status == status
    assert words in answer.error


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        (b'{"confrim": "1234"}', 400, "unknown field 'confrim'; did you mean 'confirm'?"),
        (b'{"task": "all"}', 400, "'task': expected auto, new, resume, found 'all'"),
        (b'{"cause": 7}', 400, "'cause': expected one line of text"),
        (b'{"cause": "two\\nlines"}', 400, "'cause': expected one line of text"),
        (b"[1]", 400, "expected a JSON object, found list"),
        (b"\xff\x00{", 400, "expected a JSON object"),
        (b"[" * 60000, 400, "expected a JSON object"),
        (b" " * 70000, 413, "larger than 65536 bytes"),
        (b'{"confirm": "1234"}', 409, "no plan waits under this token"),
        (b"{}", 409, "start is not possible in mode disarmed"),
    ],
)
def test_a_start_that_cannot_be_meant_so_is_refused_with_the_reason(body, status, words, robot):
    found, answer = raw(robot, post_of("start", body))
    assert found == status
    assert words in str(answer["error"])
    assert robot.get("/v1/status").body["mode"] == "disarmed"


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        (b"{}", 400, "'tank_ml': expected a number, found nothing"),
        (b'{"tank_ml": "8000"}', 400, "'tank_ml': expected a number, found str"),
        (b'{"tank_ml": true}', 400, "'tank_ml': expected a number, found bool"),
        (b'{"ml": 8000}', 400, "unknown field 'ml'"),
        (b'{"tank_ml": NaN}', 409, "a refill to nan ml: expected what the tank holds now"),
        (b'{"tank_ml": -1}', 409, "a refill to -1 ml"),
        (b'{"tank_ml": 1' + b"0" * 400 + b"}", 409, "a refill to inf ml"),
        (b'{"tank_ml": 8000}', 409, "no task is unfinished"),
    ],
)
def test_a_refill_that_cannot_be_meant_so_is_refused_with_the_reason(body, status, words, robot):
    found, answer = raw(robot, post_of("refill", body))
    assert (found, words in str(answer["error"])) == (status, True), answer


def test_a_refusal_lists_every_reason(robot):
    answer = robot.post("resume")
    assert answer.status == 409
    assert answer.body["reasons"] == ["resume is not possible in mode disarmed"]


# --- stop


@pytest.mark.parametrize(
    "request_", [
        post_of("stop", b""), post_of("stop", b'{"cause": "a test"}'), post_of("stop", b'{"caus": 1}'),
        post_of("stop", b"\xff\xfe not JSON"), post_of("stop", b"x" * 200_000), post_of("stop", b'{"ca', length=5000),
    ],
    ids=["empty", "cause", "unknown field", "no JSON", "too large", "never complete"],
)  # fmt: skip
def test_a_stop_stops_whatever_is_sent_along(request_, robot):
    status, answer = raw(robot, request_)
    assert status == 200
    assert answer["parts"] == [{"part": part, "error": ""} for part in ("valve", "base", "arm", "pump")]
    body = robot.get("/v1/status").body
    assert body["mode"] == "safe_stop"
    assert body["causes"] == ["a test" if b"a test" in request_ else "STOP over the control socket"]
    acknowledged(robot)


def test_a_stop_comes_through_while_slow_clients_hold_on_to_their_connections(robot):
    slow = []
    for number in range(50):
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(5.0)
        connection.connect(str(robot.path))
        connection.sendall(post_of("arm", b"{", length=10) if number % 2 else b"POST /v1/arm HT")
        slow.append(connection)
    began_s = time.monotonic()
    assert robot.post("stop").ok
    assert time.monotonic() - began_s < 2.0
    assert slow[0].recv(100) == b""  # the oldest had to go
    for connection in slow:
        connection.close()
    acknowledged(robot)
    assert robot.get("/v1/status").body["mode"] == "disarmed"


def test_stops_from_many_clients_at_once_all_get_their_answer(robot):
    answers = []
    clients = [threading.Thread(target=lambda: answers.append(robot.post("stop").status)) for _ in range(8)]
    for client in clients:
        client.start()
    for client in clients:
        client.join()
    assert answers == [200] * 8
    acknowledged(robot)


# --- start in two steps


def test_a_token_starts_nothing_once_the_machine_was_stopped_in_between(robot):
    assert robot.post("arm").body["mode"] == "ready"
    first = robot.post("start").body
    second = robot.post("start", task="new").body
    assert first["plan"]["stops"] == 1
    assert "a new task" in second["plan"]["summary"]
    assert robot.post("start", confirm=first["token"]).status == 409  # only the newest plan counts
    robot.post("stop")
    acknowledged(robot)
    robot.post("arm")
    late = robot.post("start", confirm=second["token"])
    assert late.status == 409
    assert any(reason.startswith("mode changes was") for reason in late.body["reasons"])
    assert robot.post("start", confirm=second["token"]).status == 409  # and it is used up
    assert robot.post("disarm").body["mode"] == "disarmed"
    assert robot.get("/v1/status").body["ledger"] is None


def test_a_stop_during_a_shot_shuts_the_valve_in_truth_and_the_shot_is_booked(tmp_path):
    with living(tmp_path, dosing={"min_ml": 10.0, "max_ml": 14.0}, task={"label_cap_ml": 500.0}) as robot:
        assert robot.post("arm").ok
        token = robot.post("start").body["token"]
        assert robot.post("start", confirm=token).body == {"task": 1}
        robot.until(lambda: robot.twin.valve_open)  # moved on by the robot's own readings
        stopped = robot.post("stop", cause="enough")
        assert {part["part"]: part["error"] for part in stopped.body["parts"]}["valve"] == ""
        body = robot.get("/v1/status").body
        assert (body["mode"], body["causes"]) == ("safe_stop", ["enough"])
    assert robot.result[0].causes[0] == "enough"
    assert len(read_truth(tmp_path / "truth.jsonl").delivered) == 1
    with LedgerReader.open_read_only(ledger_path(robot.folder / "run")) as ledger:
        shots = ledger.shots(1)
    assert [shot.result.outcome for shot in shots if shot.result] == [Outcome.SHORTENED]
    assert robot.twin.dispensed_ml < 6.0
    assert robot.twin.dispensed_ml <= sum(shot.result.booked_ml for shot in shots if shot.result)


# --- the file of the socket


def test_a_dead_robots_socket_is_taken_over_and_goes_with_its_robot(tmp_path):
    path = tmp_path / "control.sock"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))
    with ControlSocket.open(path), pytest.raises(BusyError, match="a robot answers here already"):
        ControlSocket.open(path)
    assert not path.exists()


def test_a_second_robot_is_refused_before_any_device_is_asked(robot, tmp_path):
    config = configuration(tmp_path, (0.25,), 0.5, "left", {})
    options = RunOptions(DEMO, tmp_path / "run", True, False, tmp_path / "truth.jsonl", control=robot.path)
    twin = simulated(config, options, ())
    with pytest.raises(BusyError, match=r"control\.sock: a robot answers here already"):
        run_real(run_robot(config, options, Bus(), twin=twin, signals=StopSignals()))
    twin.close_truth()
    assert read_truth(tmp_path / "truth.jsonl").processes[-1].commands == ()
    assert robot.get("/v1/status").body["mode"] == "disarmed"


def test_a_file_of_another_kind_is_left_alone(tmp_path):
    path = tmp_path / "control.sock"
    path.write_text("notes")
    with pytest.raises(FileError, match="expected the place of the control socket"):
        ControlSocket.open(path)
    assert path.read_text() == "notes"


def test_a_path_too_long_for_a_socket_is_refused_with_its_length(tmp_path):
    path = tmp_path / ("x" * 120) / "control.sock"
    with pytest.raises(ConfigError, match="at most 107 bytes"):
        ControlSocket.open(path)


def test_the_service_managers_folder_comes_before_the_run_directory(tmp_path):
    assert socket_path(tmp_path, {}) == tmp_path / "control.sock"
    assert str(socket_path(tmp_path, {"RUNTIME_DIRECTORY": "/run/sprayer:/run/x"})) == "/run/sprayer/control.sock"


def test_where_no_robot_answers_every_place_that_was_tried_is_named(tmp_path):
    (tmp_path / "plain").write_text("")
    with pytest.raises(UnavailableError, match=r"no robot answers at .*plain or .*none"):
        find_socket((tmp_path / "plain", tmp_path / "none", tmp_path / "none"))
