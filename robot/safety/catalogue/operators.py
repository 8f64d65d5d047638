"""Faults of communication, and what operators and strangers do."""

from robot.safety.catalogue.kinds import Action, Clear, FaultKind, Proof

OPERATORS = (
    FaultKind("F70a", "modem without network, PIN refused", "registration, AT time-out", 30.0,
              Action.WARN, Clear.GONE, "the messages that wait"),
    FaultKind("F70b", "message from an unknown number", "list of allowed numbers", 1.0,
              Action.WARN, Clear.PASSED, "the count; no reply", Proof.FACES),
    FaultKind("F70c", "oversize or broken message", "limits of the decoder", 1.0,
              Action.WARN, Clear.PASSED, "the raw message"),
    FaultKind("F70d", "message hours late", "the centre's stamp", 1.0,
              Action.WARN, Clear.PASSED, "STOP is honoured, START refused", Proof.FACES),
    FaultKind("F70e", "command repeated, reordered or retained", "sequence number, nonce, expiry", 1.0,
              Action.WARN, Clear.PASSED, "executed at most once", Proof.FACES),
    FaultKind("F70f", "command forged", "signature", 1.0,
              Action.WARN, Clear.PASSED, "the attempt", Proof.FACES),
    FaultKind("F70g", "broker away for a day", "age of the oldest unsent row", 60.0,
              Action.WARN, Clear.GONE, "every dose and fault row", Proof.FACES),
    FaultKind("F70h", "broker half dead", "keep-alive", 45.0,
              Action.WARN, Clear.GONE, "the loop never waits", Proof.FACES),
    FaultKind("F70i", "operator's heartbeat lost", "age of the lease's last beat", 0.7,
              Action.PAUSE, Clear.GONE, "the lease, for five seconds more"),
    FaultKind("F70j", "double press", "one shot at a time; one key a press", 0.1,
              Action.WARN, Clear.PASSED, "both requests"),
    FaultKind("F70k", "two operators at once", "one lease", 0.1,
              Action.WARN, Clear.PASSED, "who held it and who asked"),
    FaultKind("F70l", "e-stop pressed or its wire broken", "normally closed contact, read before arming", 0.2,
              Action.ESTOP, Clear.RESET, "the moment"),
    FaultKind("F70m", "e-stop released while START is held", "a start is an edge after the reset", 0.2,
              Action.ESTOP, Clear.RESET, "nothing starts"),
    FaultKind("F70n", "hostile request to the local interface", "limits of size and time, socket permissions", 1.0,
              Action.WARN, Clear.PASSED, "the control loop's rate"),
)
