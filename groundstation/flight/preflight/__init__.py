"""Pre-flight: may this configuration fly, the checks, the proof on file, the prompts, and the
arming sequence.
"""

from groundstation.flight.preflight.checks import (
    FEW_HZ,
    Checks,
    SurroundingsChecks,
    describe_checks,
    describe_failures,
    entry_of,
    explain_drops,
)
from groundstation.flight.preflight.configuration import (
    describe_trajectory,
    ensure_flyable,
    ensure_guarded,
    ensure_link,
    examine_trajectory,
    explain_fence,
    explain_refusal,
    is_simulated,
    load_link_key,
)
from groundstation.flight.preflight.prompts import (
    LISTEN_S,
    confirm_arming,
    ensure_named,
    line_from_terminal,
)
from groundstation.flight.preflight.proof import (
    Proof,
    hash_sections,
    proof_path,
    read_proof,
    save_proof,
)
from groundstation.flight.preflight.sequence import ArmingSequence, FlightEnded
