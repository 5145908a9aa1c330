"""Simulated tracking systems: what their cameras see, as the bytes that they send."""

from sim.trackers.trackers import (
    Mocap,
    NatNetServer,
    QtmServer,
    SeenVehicle,
    TrackedBody,
    Tracker,
    json_encoder,
    make_tracker,
    vicon_encoder,
)
