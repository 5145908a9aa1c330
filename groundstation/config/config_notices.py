"""Sentences about configurations, arguments and files, which every part of the program may say. Sans-IO.

The rooms above have their own sentences in ``groundstation.core.messages``, whose table takes these rows in.
"""

from links.text import NoticeTable, NoticeTemplate

CONFIG_NOTICES: tuple[NoticeTemplate, ...] = (
    # Values of keys and arguments.
    NoticeTemplate("value.choice", "expected one of {choices}, got {found!r}"),
    NoticeTemplate("value.choices", "expected some of {choices}, got {found!r}"),
    NoticeTemplate("value.form", "expected {form}, got {found!r}"),
    NoticeTemplate("value.refused", "{value}: {why}"),
    # Files.
    NoticeTemplate("file.missing", "{path} does not exist"),
    NoticeTemplate("file.no_folder", "{path} is no folder"),
    NoticeTemplate("file.empty", "empty: what wrote it may not have finished"),
    NoticeTemplate("file.exists", "{path} is there already", "name another, or remove it"),
    NoticeTemplate("file.unread", "cannot read {path}: {why}"),
    NoticeTemplate("file.unwritten", "cannot write {path}: {why}"),
    NoticeTemplate("file.old_value_unwritten", "cannot keep the old value in {path}: {why}"),
    NoticeTemplate(
        "file.log_unwritten", "cannot write {path}, which the ground station behind the dashboard needs: {why}"
    ),
    NoticeTemplate("file.not_utf8", "not UTF-8 text (byte {at})", "save it as UTF-8"),
    NoticeTemplate("file.ending", "expected a name that ends in {ending}, got {found!r}"),
    NoticeTemplate("file.markers", "{path} needs a line {begin} and below it a line {end}, once each"),
    # Configurations, and the code that they name.
    NoticeTemplate("config.unknown_name", "expected one of {choices}, got {found!r}{nearest}"),
    NoticeTemplate("config.override", "expected key=value, such as vehicle.mass_kg=0.08, got {text!r}"),
    NoticeTemplate("config.unread", "cannot read the configuration: {why}"),
    NoticeTemplate("config.switched", "{why}; add --set {key}=VALUE"),
    NoticeTemplate("config.depth", "no configuration: its tables or arrays are nested more than {most} deep"),
    NoticeTemplate("config.not_toml", "not valid TOML: {why}"),
    NoticeTemplate("config.two_sources", "preset and file exclude each other; a file may name a preset itself"),
    NoticeTemplate("code.no_attribute", "{module} has no attribute {name!r}"),
    NoticeTemplate("code.no_import", "can't import {module}"),
    NoticeTemplate("code.no_result", "{factory} failed"),
    NoticeTemplate("code.failed", "{what}: {why}"),
    NoticeTemplate("code.no_module", "{what}: {why} (is it installed, or its folder on PYTHONPATH?)"),
    NoticeTemplate("package.needed", "needs {package}, which is not installed", "{command}{more}"),
)

config_notice = NoticeTable(CONFIG_NOTICES).notice
"""Makes a sentence of this table from the id of its row and its numbers."""
