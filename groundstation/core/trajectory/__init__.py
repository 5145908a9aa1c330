"""Trajectories with exact derivatives, and their demands on a vehicle."""

from groundstation.core.trajectory.feasibility import Demand, FeasibilityReport, check_feasibility
from groundstation.core.trajectory.reference import (
    FASTEST_M_S,
    LATEST_S,
    Reference,
    Trajectory,
)
from groundstation.core.trajectory.shapes import (
    ExcitationConfig,
    Hold,
    LemniscateConfig,
    OwnTrajectoryConfig,
    TrajectoryConfig,
)
from groundstation.core.trajectory.transitions import Blend, Chain, Limits, blend, run_in, stop
from groundstation.core.trajectory.waypoints import parse_course
