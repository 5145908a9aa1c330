"""The heart of a flight, sans-IO: what is computed from poses to commands, and what is refused."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.core.pilot import NOISE_POSES, Pilot


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
