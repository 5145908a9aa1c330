"""Configuration: TOML files and overrides into frozen structs, with errors that name the key."""

from groundstation.config.config_notices import CONFIG_NOTICES, config_notice
from groundstation.config.errors import (
    ArgumentError,
    ConfigError,
    Problem,
    dotted_key,
    locate,
    refuse_io,
    refuse_value,
)
from groundstation.config.loader import convert, from_dict, load
from groundstation.config.numbers import parse_number, parse_whole_number
from groundstation.config.retired import RETIRED_KEYS, RetiredKeyWarning
from groundstation.config.schema import (
    FACTORY,
    NAME,
    NAME_FORM,
    NAME_LETTERS,
    WHOLE_NAME,
    OpenFactory,
    describe_pattern,
    describe_type,
    field_descriptions,
    is_name,
    is_within_bounds,
    keys_of,
    strip_metadata,
    structs,
    suggest,
    texts_of,
)
from groundstation.config.sections import (
    FromFile,
    copy_examples,
    example_text,
    list_examples,
    presets,
    resolve_files,
    shipped_texts,
)
from groundstation.config.toml_text import dump, parse_toml, read_toml, round_digits, write_value
from groundstation.config.user_code import (
    MAKING_LIMIT_S,
    STEP_LIMIT_S,
    STEP_WATCH,
    Option,
    StepWatch,
    UserCodeFault,
    call_factory,
    coroutine_hint,
    describe_error,
    find_object,
    lend,
    name_object,
    needed_names,
    several,
    without_frames,
)
