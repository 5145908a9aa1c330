"""The serial RF link: a transmitter module, whose frames a process of its own paces."""

from links.rf.betaflight_codec import (
    PROMPT,
    BoardMode,
    MspReader,
    describe_change,
    describe_pulses,
    encode_request,
    find_refusal,
    find_settings,
    is_armed,
)
from links.rf.board import Board
from links.rf.channel_map import Channels
from links.rf.codec import Manner, RfFrame, RfLinkConfig, Service
from links.rf.link import SILENT_S, PacedLink, SerialRfLink, end_pacer
from links.rf.module_codec import (
    RF_CODECS,
    CrsfLinkConfig,
    DsmLinkConfig,
    RfConfig,
    encode_attitude,
)
from links.rf.pacer import (
    AFTERLIFE_S,
    Arm,
    End,
    FramePacer,
    Give,
    Hear,
    OpenPacer,
    Order,
    Pacer,
    PacerReport,
    Serve,
    StandbyWatch,
    Stop,
)
from links.rf.pacer_process import open_process
from links.rf.shared_memory import CAPACITY_BYTES, Mailbox
