"""What a process of ours needs of its machine: clocks, sockets' places, locks, exit codes."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from groundstation.runtime.clock import IdleSlots, cancel_task, precise_loop, sleep_until, to_the_end, wall_ms
    from groundstation.runtime.document import fill_markers, replace_between_markers, split_at_markers
    from groundstation.runtime.entry import (
        VIEWERS,
        Exit,
        LazyParser,
        add_completion,
        build_parser,
        path,
        rare_collections,
        raw_stream,
        require_package,
        run,
        viewer,
    )
    from groundstation.runtime.outlets import Latest, NonBlockingWriter
    from groundstation.runtime.recordings import (
        RecordingConfig,
        folder_of,
        free_name,
        is_being_written,
        list_recordings,
        make_folder,
        open_private,
        tidy,
    )
    from groundstation.runtime.register import (
        BRIDGE,
        FILE,
        SERVICES,
        ApiError,
        Running,
        StatusConfig,
        Taken,
        claim_socket,
        find_socket,
        follow_parent,
        foreign_services,
        hold_lock,
        is_ours,
        is_served,
        lock_path,
        own_directory,
        owner,
        registration,
        running_processes,
        send_signal,
        served_sockets,
        socket_folder,
        socket_path,
    )
    from groundstation.runtime.version import __version__


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
