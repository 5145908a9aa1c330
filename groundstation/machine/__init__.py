"""Machine services for a process of ours: clocks, sockets' places, locks, folders of recordings."""

from groundstation.machine.clock import (
    NICE,
    IdleSlots,
    cancel_task,
    precise_loop,
    sleep_until,
    to_the_end,
    wait_at_most,
    wake,
    wall_ms,
)
from groundstation.machine.document import fill_markers, replace_between_markers
from groundstation.machine.files import open_whole, write_whole
from groundstation.machine.outlets import Latest, NonBlockingWriter
from groundstation.machine.recordings import (
    RecordingConfig,
    folder_of,
    free_name,
    is_being_written,
    list_flights,
    list_recordings,
    make_folder,
    open_private,
    tidy,
)
from groundstation.machine.register import (
    BRIDGE,
    FILE,
    FLEET,
    ApiError,
    Running,
    StatusConfig,
    Taken,
    claim_socket,
    explain_stop,
    find_socket,
    follow_parent,
    foreign_services,
    hold_lock,
    is_ours,
    is_served,
    note_stop,
    own_directory,
    owner,
    registration,
    running_processes,
    send_signal,
    served_sockets,
    socket_folder,
    socket_path,
)
