"""One or more scenarios a fault of the catalogue, grouped as the catalogue is."""

from .buses import BUSES
from .host import HOST
from .liquid import LIQUID
from .operators import OPERATORS
from .perception import PERCEPTION
from .values import Scenario, Scenarios, Seen, Stage

GROUPS: tuple[Scenarios, ...] = (BUSES, HOST, PERCEPTION, LIQUID, OPERATORS)
SCENARIOS: Scenarios = {fault_id: cases for group in GROUPS for fault_id, cases in group.items()}

__all__ = ["GROUPS", "SCENARIOS", "Scenario", "Scenarios", "Seen", "Stage"]
