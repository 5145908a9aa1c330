"""Sentences about configurations, arguments and files, which every part of the program may say.

Sans-IO.

The rooms above have their own sentences in ``groundstation.core.messages``, whose table takes these
rows in.
"""

from groundstation.config.key_notices import KEY_NOTICES
from links.text import LINK_NOTICES, NoticeTable, NoticeTemplate

CONFIG_NOTICES: tuple[NoticeTemplate, ...] = (
    *KEY_NOTICES,
    # Values of keys and arguments.
    NoticeTemplate("value.choice", "expected one of {choices}, got {found!r}"),
    NoticeTemplate("value.choices", "expected some of {choices}, got {found!r}"),
    NoticeTemplate("value.path", "expected a path, got ''"),
    NoticeTemplate("value.form", "expected {form}, got {found!r}"),
    NoticeTemplate(
        "value.seconds", "expected seconds, more than {above:g} and at most {most:g}, got {found!r}"
    ),
    NoticeTemplate("value.count", "expected {least} to {most}, got {count}"),
    NoticeTemplate("value.whole_number", "expected a whole number, {least} or more, got {found!r}"),
    NoticeTemplate("value.underscore", "expected a number without `_`, got {found!r}"),
    NoticeTemplate("value.refused", "{value}: {why}"),
    NoticeTemplate(
        "command.divided", "write the options before or behind all other words, not between them"
    ),
    NoticeTemplate("command.gone", "`{words}` is gone", "{instead}"),
    NoticeTemplate("option.only_with", "is for {option} alone", "leave it out"),
    NoticeTemplate(
        "option.all_and_name", "writes all of them, and {name!r} with them", "leave one out"
    ),
    # Files.
    NoticeTemplate("file.no_folder", "{path} is no folder"),
    NoticeTemplate("file.is_file", "it is a file, not a folder"),
    NoticeTemplate("file.empty", "empty: what wrote it may not have finished"),
    NoticeTemplate("file.exists", "{path} is there already", "name another, or remove it"),
    NoticeTemplate("file.old_value_unwritten", "cannot keep the old value in {path}: {why}"),
    NoticeTemplate(
        "file.log_unwritten",
        "cannot write {path}, which the ground station behind the dashboard needs: {why}",
    ),
    NoticeTemplate("file.too_large", "larger than {most_mb:g} MB, or endless"),
    NoticeTemplate("file.not_utf8", "not UTF-8 text (byte {at})", "save it as UTF-8"),
    NoticeTemplate("file.ending", "expected a name that ends in {ending}, got {found!r}"),
    NoticeTemplate("file.unusable", "cannot use {path}: {why}"),
    NoticeTemplate(
        "file.mode", "{path} has mode {mode}, so others may read it", "change it, then chmod 600"
    ),
    NoticeTemplate(
        "file.markers", "{path} needs a line {begin} and below it a line {end}, once each"
    ),
    # Stations on this machine, and their sockets.
    NoticeTemplate(
        "station.nobody",
        "nobody flies {whom} here (looked in {folder} and {services})",
        "name it by --vehicle, or its socket by --socket; `groundstation fly CONFIG --tui` starts "
        "one",
    ),
    NoticeTemplate(
        "station.several",
        "more than one could be meant: name one by --vehicle or --socket: {sockets}",
    ),
    NoticeTemplate(
        "station.stopped",
        "nothing is armed: all flights were ordered to land {age_s:.1f} s ago (stop-all), and this "
        "program had begun already",
        "start it again to fly",
    ),
    NoticeTemplate(
        "station.taken",
        "{vehicle} is flown by another ground station already (process {pid}, lock {path})",
        "stop that one, or give this one another vehicle.name or status.path",
    ),
    NoticeTemplate("socket.no_folder", "folder {folder} of the status socket: {why}"),
    NoticeTemplate(
        "socket.open_folder",
        "folder {folder} of the status socket must be a folder that belongs to you and that "
        "nobody else may write to: another program could take the socket's place; set status.path",
    ),
    NoticeTemplate(
        "socket.other_file",
        "status socket {path}: a file that is not a socket is there; move it away",
    ),
    NoticeTemplate(
        "socket.taken",
        "status socket {path}: another ground station is serving this vehicle; stop it, or give "
        "this one another vehicle.name or status.path",
    ),
    NoticeTemplate(
        "socket.failed", "status socket {path}: {why}", "set status.path to another one"
    ),
    # Configurations, and the code that they name.
    NoticeTemplate("config.unknown_name", "expected one of {choices}, got {found!r}{nearest}"),
    NoticeTemplate(
        "config.override", "expected key=value, such as vehicle.mass_kg=0.08, got {text!r}"
    ),
    NoticeTemplate("config.unread", "cannot read the configuration: {why}"),
    NoticeTemplate("config.switched", "{why}; add --set {key}=VALUE"),
    NoticeTemplate(
        "config.depth", "no configuration: its tables or arrays are nested more than {most} deep"
    ),
    NoticeTemplate("config.digits", "line {line}: a number of more than {most:,} digits"),
    NoticeTemplate("config.not_toml", "not valid TOML: {why}"),
    NoticeTemplate(
        "config.two_sources", "preset and file exclude each other; a file may name a preset itself"
    ),
    NoticeTemplate("code.no_attribute", "{module} has no attribute {name!r}"),
    NoticeTemplate("code.no_import", "can't import {module}"),
    NoticeTemplate("code.no_result", "{factory} failed"),
    NoticeTemplate(
        "code.no_module", "{value}: {why} (is it installed, or its folder on PYTHONPATH?)"
    ),
    NoticeTemplate("code.returned", "{what} returned a {type}, not a {wanted}{hint}"),
    NoticeTemplate(
        "controller.not_callable",
        "{factory} is not callable: expected factory(vehicle, options) -> Controller, or an "
        "object with decide(estimate, reference, interval_s)",
    ),
    NoticeTemplate(
        "controller.no_decide",
        "{factory} made a {type} without decide(estimate, reference, interval_s)",
    ),
    NoticeTemplate(
        "controller.no_command", "{what} returned something else than one thrust and three rates"
    ),
    NoticeTemplate(
        "controller.not_finite", "{what} commanded thrust {thrust} N, rates {rates} rad/s"
    ),
    NoticeTemplate("trajectory.no_at", "{factory} made a {type} without at(time_s) -> Reference"),
    NoticeTemplate("trajectory.attribute", "{name}.{attribute} failed"),
    NoticeTemplate(
        "trajectory.seconds", "{name} has {attribute} = {found!r}: expected seconds, 0 or more"
    ),
    NoticeTemplate(
        "trajectory.joints",
        "{name} has joints_s = {found!r}: expected rising times, its beginning and its end among "
        "them",
    ),
    NoticeTemplate("trajectory.vectors", "{what}: expected vectors of three numbers in {found}"),
    NoticeTemplate("trajectory.not_finite", "{what} returned {found} at {time_s:g} s"),
    NoticeTemplate(
        "package.no_simulator",
        "groundstation.{name} flies in the simulator, the package sim, which is not installed",
    ),
    NoticeTemplate("package.needed", "needs {package}, which is not installed", "{command}"),
    NoticeTemplate(
        "package.needed_for_pictures",
        "needs {package}, which is not installed",
        "{command}; --json does without",
    ),
)

config_notice = NoticeTable((*LINK_NOTICES, *CONFIG_NOTICES)).notice
"""Makes a sentence of this table, or of the links', from the id of its row and its numbers."""
