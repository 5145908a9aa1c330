"""What prepares a laboratory and its vehicles: parameters, axes, propellers off, several vehicles."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.lab.doctor import DoctorOrders, run_doctor
    from groundstation.lab.fleet import FleetPlan, Member, read_fleet
    from groundstation.lab.pose_monitor import carry_command, watch_poses
    from groundstation.lab.pose_stream import MOVES, CarryMove
    from groundstation.lab.props_off import props_off_command
    from groundstation.lab.relay import Relay, run_relay


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
