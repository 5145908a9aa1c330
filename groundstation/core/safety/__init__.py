"""What refuses or ends a flight: guards, geofence, separation, evidence against the poses, take-off and touchdown."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.safety.conviction import WITNESS, Charge, Conviction, charge_lateness
    from groundstation.core.safety.escalation import Escalation, Finding, Since, Step
    from groundstation.core.safety.fence import Fence, FenceConfig
    from groundstation.core.safety.guards import Guards, GuardsConfig
    from groundstation.core.safety.liftoff import WANDERING_M
    from groundstation.core.safety.live_gains import LIVE, PREFIX, RAMP_S, STEP_FACTOR, LiveGains
    from groundstation.core.safety.obedience import NODE_S, STILL_SUSPECTS, Contradiction, Obedience
    from groundstation.core.safety.separation import Separation, SeparationConfig
    from groundstation.core.safety.takeoff import Spool, SpoolUp, Standing, TakeoffConfig, limit_n, usual_limit_n
    from groundstation.core.safety.touchdown import CERTAIN_S, Hover, LandingConfig, Touchdown
    from groundstation.core.safety.witness import ASKEW_DEG, Agreement, Witness

_MODULES = {
    "conviction": ("Charge", "Conviction", "WITNESS", "charge_lateness"),
    "escalation": ("Escalation", "Finding", "Since", "Step"),
    "fence": ("Fence", "FenceConfig"),
    "guards": ("Guards", "GuardsConfig"),
    "liftoff": ("WANDERING_M",),
    "live_gains": ("LIVE", "LiveGains", "PREFIX", "RAMP_S", "STEP_FACTOR"),
    "obedience": ("Contradiction", "NODE_S", "Obedience", "STILL_SUSPECTS"),
    "separation": ("Separation", "SeparationConfig"),
    "takeoff": ("Spool", "SpoolUp", "Standing", "TakeoffConfig", "limit_n", "usual_limit_n"),
    "touchdown": ("CERTAIN_S", "Hover", "LandingConfig", "Touchdown"),
    "witness": ("ASKEW_DEG", "Agreement", "Witness"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
