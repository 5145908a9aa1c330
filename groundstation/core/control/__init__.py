"""Our controller: the backstepping law, its certificate, and how a vehicle is brought down."""

from groundstation.core.control.adaptive import (
    CALM,
    HOLD,
    Adaptive,
    DecreaseProof,
    Gains,
    bound_decrease,
    calm_gains,
    hold_gains,
)
from groundstation.core.control.attitude import (
    acceleration,
    clamp_command,
    half_angle_error,
    length,
    sine_error,
    specific_thrust,
    turning,
)
from groundstation.core.control.backstepping import Law, LawState, backstep, compute_yaw_rate
from groundstation.core.control.bring_down import OFF, plan_bring_down
from groundstation.core.control.certificate import (
    SUSPENDED,
    VIOLATED,
    CertificateMonitor,
    thrust_bound,
)
from groundstation.core.control.controllers import ControllerConfig, Custom, make_controller
from groundstation.core.control.demand_limits import DemandLimits
from groundstation.core.control.descent import Descent, blind_descent_limit_s, level
from groundstation.core.control.excitation import SUSPECT_LEVEL, ExcitationTones
from groundstation.core.control.limits import (
    FIRST_CLIMB_M,
    UPLINK_LOST_SHARE,
    FlightLimits,
    LimitInput,
)
from groundstation.core.control.model_descent import plan_model_descent
from groundstation.core.control.profiles import (
    DESCENT_LIMITS,
    HOLDING,
    TRACKING,
    TRANSIT,
    FlightProfile,
    GainSchedule,
    GainSet,
)
