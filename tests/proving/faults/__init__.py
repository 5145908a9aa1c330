"""The fault deck: one thing is broken in every state of a mission."""

from tests.proving.faults.cell import NotReached, fly_here, fly_together
from tests.proving.faults.deal import deal_cells, fly_all, pick_worst, quick
from tests.proving.faults.fault import MOMENTS, REASONS, Exemption, Fault, Meddler, Poses, Scene
from tests.proving.faults.faults import BROKEN, FAULTS, STATES
from tests.proving.faults.judge import Row
from tests.proving.faults.pictures import Struck, still
from tests.proving.faults.table import text, write
