"""Simulated flights, one or several, and their judge."""

from sim.runs.fleet import FleetMission, fly_fleet
from sim.runs.flight import (
    CONFIRM_S,
    LIMIT_S,
    MISSION_CONFIRM_S,
    MissionResult,
    confirm_at,
    fly,
    fly_mission,
    from_floor,
)
from sim.runs.referee import BACK_M, CRASH_M, Effort, FlightVerdict, sought
from sim.runs.server import serve, serve_fleet
from sim.runs.simulation import (
    DURATION_S,
    RECORDING,
    Run,
    check_duration,
    check_whole,
    lend_name,
    run_beside,
    simulate,
)
from sim.runs.stage import Stage
from sim.runs.workers import Flyers
