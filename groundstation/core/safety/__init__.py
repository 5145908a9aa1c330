"""Safety: guards, geofence, separation, live gains, take-off, touchdown."""

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
from groundstation.core.safety.live_gains import LIVE, PREFIX, RAMP_S, STEP_FACTOR, LiveGains
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
