"""The serial RF link: thrust and body rates as a transmitter's channels, paced by a process of this machine."""

from links.rf.codecs import RfLinkConfig
from links.rf.paced_link import PacedLink
from links.rf.pacer_messages import OpenPacer
from links.rf.pacer_process import open_process


class SerialRfLink(PacedLink):
    """Implements :class:`links.core.port.CommandLink` (see there)."""

    def __init__(
        self,
        config: RfLinkConfig,
        *,
        thrust_max_n: float,
        thrust_curve: float = 0.0,
        open_pacer: OpenPacer = open_process,
    ) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust at full throttle [N].

        ``thrust_curve`` is the curve in force (links/core/thrust_curve.py); ``open_pacer`` starts the pacer: in another
        process, or wherever a simulation has it.
        """
        config = config.with_thrust_curve(thrust_curve)
        super().__init__(config.manner, lambda hear: open_pacer(config, thrust_max_n, hear))
