"""Which stages compute the flights of a batch: numpy's, or compiled ones. Their figures are the same to the bit."""

from groundstation.config import ConfigError
from sim.batch.kernel import check
from sim.batch.stages import Compiled, Numpy, Stages


def chosen(kernel: str) -> tuple[Stages, str]:
    """The stages for ``kernel``: "numpy", "c", or "auto", which is "c" where that works; and what a user should know.

    Raises:
        ConfigError: "c" does not work here; why.
    """
    if kernel == "numpy":
        return Numpy, ""
    try:
        check()
    except OSError as error:
        if kernel == "c":
            raise ConfigError("--kernel", f"{error}; auto and numpy fly without") from None
        return Numpy, f"numpy flies, at half the speed of compiled code: {error}"
    return Compiled, ""
