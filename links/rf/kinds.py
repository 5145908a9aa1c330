"""Every codec of a serial RF module, by the name that a configuration gives it. A new one is a file and a line here."""

from links.rf.codec import RfLinkConfig
from links.rf.crsf_codec import CrsfLinkConfig
from links.rf.dsm_codec import DsmLinkConfig

RF_CODECS: dict[str, type[RfLinkConfig]] = {"dsm": DsmLinkConfig, "crsf": CrsfLinkConfig}

RfConfig = DsmLinkConfig | CrsfLinkConfig
"""The configuration of one of them."""
