"""The fault deck: one thing is broken in every state of a mission."""

from tests.proving.faults.cell import NEAR, Cell, DeckFlight, fly_together
from tests.proving.faults.deal import deal_cells, fly_all
from tests.proving.faults.fault import (
    MOMENTS,
    REASONS,
    Exemption,
    Fault,
    Kind,
    Meddler,
    Poses,
    Scene,
    Strike,
    stand_between,
)
from tests.proving.faults.faults import CASES, FAULTS, comes_late, find_fault, shows
from tests.proving.faults.judge import STRICT, TOUCHDOWN_M_S, Row
from tests.proving.faults.pictures import still
from tests.proving.faults.table import is_within, page, text
