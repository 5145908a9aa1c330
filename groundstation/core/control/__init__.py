"""Our controller: the backstepping law, its certificate, and how a vehicle is brought down."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.control.adaptive import Adaptive, bound_decrease
    from groundstation.core.control.attitude import acceleration, half_angle_error, length, push, sine_error, turning
    from groundstation.core.control.backstepping import backstep, yaw_rate
    from groundstation.core.control.bring_down import OFF, plan_bring_down
    from groundstation.core.control.certificate import acceleration_sup, measure, noise_power, thrust_bound
    from groundstation.core.control.decision import decided, limited
    from groundstation.core.control.descent import Descent
    from groundstation.core.control.gains import Gains, Law, Uncompensated
    from groundstation.core.control.model_descent import plan_model_descent
    from groundstation.core.control.watch import LASTING_S, SUSPENDED, VIOLATED, Seen, Watch

_MODULES = {
    "adaptive": ("Adaptive", "bound_decrease"),
    "attitude": ("acceleration", "half_angle_error", "length", "push", "sine_error", "turning"),
    "backstepping": ("backstep", "yaw_rate"),
    "bring_down": ("OFF", "plan_bring_down"),
    "certificate": ("acceleration_sup", "measure", "noise_power", "thrust_bound"),
    "decision": ("decided", "limited"),
    "descent": ("Descent",),
    "gains": ("Gains", "Law", "Uncompensated"),
    "model_descent": ("plan_model_descent",),
    "watch": ("LASTING_S", "SUSPENDED", "Seen", "VIOLATED", "Watch"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
