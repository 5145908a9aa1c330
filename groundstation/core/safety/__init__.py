"""What refuses or ends a flight: guards, geofence, separation, evidence against the poses, take-off and touchdown."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.safety.geofence import Fence, FenceConfig, Separation, SeparationConfig
    from groundstation.core.safety.guards import (
        WITNESS,
        Charge,
        Conviction,
        Escalation,
        GuardAction,
        GuardFinding,
        Guards,
        GuardsConfig,
        Parole,
        Since,
        charge_age,
        charge_lateness,
    )
    from groundstation.core.safety.live_gains import LIVE, PREFIX, RAMP_S, STEP_FACTOR, LiveGains
    from groundstation.core.safety.obedience import NODE_S, STILL_SUSPECTS, Obedience, PoseEvidence
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

_MODULES = {
    "geofence": ("Fence", "FenceConfig", "Separation", "SeparationConfig"),
    "guards": (
        "Charge",
        "Conviction",
        "Escalation",
        "GuardAction",
        "GuardFinding",
        "Guards",
        "GuardsConfig",
        "Parole",
        "Since",
        "WITNESS",
        "charge_age",
        "charge_lateness",
    ),
    "live_gains": ("LIVE", "LiveGains", "PREFIX", "RAMP_S", "STEP_FACTOR"),
    "obedience": ("NODE_S", "Obedience", "PoseEvidence", "STILL_SUSPECTS"),
    "takeoff": (
        "NUDGE_SHARE",
        "Nudge",
        "Spool",
        "SpoolUp",
        "StandingPoses",
        "TakeoffConfig",
        "WANDERING_M",
        "limit_n",
        "usual_limit_n",
    ),
    "touchdown": ("CERTAIN_S", "Hover", "LandingConfig", "Touchdown"),
    "witness": ("ASKEW_DEG", "Agreement", "PoseLatency", "Witness"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
