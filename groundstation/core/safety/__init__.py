"""What refuses or ends a flight: guards, geofence, separation, evidence against the poses, take-off and touchdown."""

from groundstation.core.safety.geofence import Fence, FenceConfig, Separation, SeparationConfig
from groundstation.core.safety.guards import (
    WITNESS,
    Charge,
    Conviction,
    DescentMonitor,
    Escalation,
    GuardAction,
    GuardFinding,
    Guards,
    GuardsConfig,
    Parole,
    Resets,
    Since,
    charge_age,
    charge_lateness,
    charge_place,
)
from groundstation.core.safety.live_gains import LIVE, PREFIX, RAMP_S, STEP_FACTOR, LiveGains
from groundstation.core.safety.obedience import NODE_S, STILL_SUSPECTS, Obedience, PoseEvidence, ResponseLatency
from groundstation.core.safety.takeoff import (
    NUDGE_SHARE,
    WANDERING_M,
    Nudge,
    Spool,
    SpoolUp,
    StandingPoses,
    TakeoffConfig,
    limit_n,
    usual_limit_n,
)
from groundstation.core.safety.touchdown import CERTAIN_S, Hover, LandingConfig, Touchdown
from groundstation.core.safety.witness import ASKEW_DEG, Agreement, PoseLatency, Witness
