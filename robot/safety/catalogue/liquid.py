"""Faults of liquid and energy."""

from robot.safety.catalogue.kinds import Action, Clear, FaultKind

LIQUID = (
    FaultKind("F65", "tank empty", "balance of the ledger", 1.0,
              Action.PAUSE, Clear.GONE, "the targets that are not done"),
    FaultKind("F66", "nozzle clogged or worn", "flow meter against the model", 1.0,
              Action.SAFE_STOP, Clear.ACKNOWLEDGED, "the target's fate: uncertain"),
    FaultKind("F67", "no pressure", "pressure does not come within fluid.pressure_timeout_s", 20.0,
              Action.SAFE_STOP, Clear.ACKNOWLEDGED, "the pressure"),
    FaultKind("F68", "product or dilution entered wrong", "label cap; another product is another task", 1.0,
              Action.SAFE_STOP, Clear.RESTARTED, "refused at the start"),
    FaultKind("F69", "battery low", "voltage, averaged over ten readings", 5.0,
              Action.PAUSE, Clear.GONE, "the voltage"),
    FaultKind("F69b", "battery all but empty", "voltage, averaged over ten readings", 5.0,
              Action.SAFE_STOP, Clear.ACKNOWLEDGED, "the voltage"),
)
