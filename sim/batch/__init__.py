"""Many flights at once: the same law, estimator and plant on arrays of vehicles."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.batch.batch import fly_batch, require_batchable, zeros


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
