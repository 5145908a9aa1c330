"""One flight: pre-arm checks, mission, command loop, shutdown, statistics."""

from groundstation.flight.assembly import Give, WireTaps, about, make_ends, make_flight, recorder
from groundstation.flight.command_loop import DISARM_WAIT_S, FrameLateness
from groundstation.flight.flight import Flight, FlightOutcome
from groundstation.flight.hold_to_run import HoldWatch, ensure_held, make_hold
from groundstation.flight.prearm import (
    Company,
    Proof,
    confirm_arming,
    describe_checks,
    describe_failures,
    describe_trajectory,
    ensure_flyable,
    ensure_guarded,
    ensure_link,
    ensure_named,
    entry_of,
    examine_trajectory,
    explain_drops,
    explain_fence,
    explain_refusal,
    hash_sections,
    is_simulated,
    line_from_terminal,
    load_link_key,
    proof_path,
    save_proof,
)
from groundstation.flight.step_timer import StepTimeout, StepTimer
