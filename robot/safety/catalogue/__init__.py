"""The fault catalogue: what can go wrong, how it is noticed, what is done, within what time, and what ends it.

Code, tests, and docs/safety.md read this one table; no configuration can loosen it.
"""

from robot.safety.catalogue.buses import BUSES
from robot.safety.catalogue.host import HOST
from robot.safety.catalogue.kinds import Action, Clear, FaultKind, Proof
from robot.safety.catalogue.liquid import LIQUID
from robot.safety.catalogue.operators import OPERATORS
from robot.safety.catalogue.perception import PERCEPTION

CATALOGUE: tuple[FaultKind, ...] = (*BUSES, *HOST, *PERCEPTION, *LIQUID, *OPERATORS)

__all__ = ["CATALOGUE", "Action", "Clear", "FaultKind", "Proof"]
