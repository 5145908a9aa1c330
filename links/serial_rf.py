"""The serial RF link: thrust and body rates as a transmitter's channels, paced by a process of this machine."""

from links.paced_link import PacedLink
from links.pacer_messages import OpenPacer
from links.pacer_process import open_process
from links.rf_codec import RfLinkConfig


class SerialRfLink(PacedLink):
    """Implements :class:`links.port.CommandLink` (see there)."""

    def __init__(
        self,
        config: RfLinkConfig,
        *,
        thrust_max_n: float,
        thrust_curve: float = 0.0,
        open_pacer: OpenPacer = open_process,
    ) -> None:
        """Nothing is opened yet; ``thrust_max_n`` is the thrust at full throttle [N].

        ``thrust_curve`` is the curve in force (links/thrust_curve.py); ``open_pacer`` starts the pacer: in another
        process, or wherever a simulation has it.
        """
        config = config.with_thrust_curve(thrust_curve)
        super().__init__(config.manner, lambda hear: open_pacer(config, thrust_max_n, hear))
