"""Every codec of a serial RF module, by the name that a configuration gives it. A new one is a file and a line here."""

from links.crsf_codec import CrsfLinkConfig
from links.dsm_codec import DsmLinkConfig
from links.rf_codec import RfLinkConfig

RF_CODECS: dict[str, type[RfLinkConfig]] = {"dsm": DsmLinkConfig, "crsf": CrsfLinkConfig}

RfConfig = DsmLinkConfig | CrsfLinkConfig
"""The configuration of one of them."""
