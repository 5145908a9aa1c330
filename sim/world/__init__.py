"""The truth of a simulated flight: plant, wind, vehicle, and the scenarios."""

from sim.world.airframe import (
    Airframe,
    AttitudeEstimator,
    PositionWander,
    SimulatedVehicle,
    with_noise,
)
from sim.world.draws import generator, normals, rows
from sim.world.hand import HOLD_S, MOVE_S, make_hand
from sim.world.plant import AirDrag, Body, FourRotors, Physics, compute_drag, integrate
from sim.world.quadrotor import Quadrotor, TrueState
from sim.world.world import (
    STILL,
    RotorConstants,
    SteadyWind,
    Wind,
    WindTunnel,
    World,
    advance_turbulence,
    begin_turbulence,
    compute_steady,
    compute_turbulence,
    find_grid_step,
)
