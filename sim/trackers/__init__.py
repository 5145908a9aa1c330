"""Simulated tracking systems: what their cameras see, as the bytes that they send."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.trackers.trackers import (
        Mocap,
        NatNetServer,
        QtmServer,
        TrackedBody,
        Tracker,
        json_encoder,
        make_tracker,
        vicon_encoder,
        vision_encoder,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
