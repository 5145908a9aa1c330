"""Safety: guards, geofence, separation, health of the poses, take-off, touchdown, second
witness.
"""

from groundstation.core.safety.geofence import Fence, FenceConfig, Separation, SeparationConfig
from groundstation.core.safety.guards import (
    GUARDS,
    LATE_PERIODS,
    Escalation,
    Guard,
    GuardAction,
    GuardFinding,
    Guards,
    GuardsConfig,
    list_limits,
)
from groundstation.core.safety.health import SUSPECT_M_S2, Failure, HealthState, PoseHealth
from groundstation.core.safety.latency import PoseLatency, ResponseLatency
from groundstation.core.safety.live_gains import LIVE, PREFIX, RAMP_S, STEP_FACTOR, LiveGains
from groundstation.core.safety.monitors import MONITORS, Monitors
from groundstation.core.safety.pose_gate import PoseGate
from groundstation.core.safety.takeoff import (
    WANDERING_M,
    Spool,
    SpoolUp,
    StandingPoses,
    TakeoffConfig,
    limit_n,
    usual_limit_n,
)
from groundstation.core.safety.touchdown import (
    CERTAIN_S,
    NEAR_M,
    OFF_REFERENCE_M,
    LandingConfig,
    Touchdown,
)
from groundstation.core.safety.witness import MOUNTING_DEG, Agreement, Witness
