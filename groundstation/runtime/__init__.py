"""Start and end of a program: launcher, command line, exit codes, version. Quick to load."""

from groundstation.runtime.entry import (
    COMPLETION,
    DAY_S,
    Arguments,
    Exit,
    Groups,
    Program,
    add_arguments,
    build_parser,
    json_argument,
    path,
    raw_stream,
    require_package,
    run,
    seconds,
)
from groundstation.runtime.packages import describe_install
from groundstation.runtime.version import __version__
