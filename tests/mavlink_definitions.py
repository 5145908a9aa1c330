"""The message definitions of pymavlink's ardupilotmega as lines of links/mavlink_definitions.py, made anew by

python -m tests.mavlink_definitions
"""

import inspect
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega

WHERE = Path(__file__).parents[1] / "links" / "mavlink_definitions.py"
TYPES = {
    "double": "d", "float": "f", "uint64_t": "Q", "int64_t": "q", "uint32_t": "I", "int32_t": "i", "uint16_t": "H",
    "int16_t": "h", "uint8_t": "B", "int8_t": "b", "char": "s",
}  # fmt: skip


def line(kind: Any) -> str:
    """One message."""
    lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    parameters = inspect.signature(kind.__init__).parameters
    words = [str(kind.id), kind.msgname]
    for name, kind_of in zip(kind.fieldnames, kind.fieldtypes, strict=True):
        later = parameters[name].default is not inspect.Parameter.empty
        if later and "|" not in words:
            words.append("|")
        words.append(f"{name}:{lengths[name] or ''}{TYPES[kind_of]}")
    return " ".join(words)


def definitions() -> str:
    """All lines, by number."""
    return "\n".join(line(ardupilotmega.mavlink_map[number]) for number in sorted(ardupilotmega.mavlink_map))


if __name__ == "__main__":
    head, _, _ = WHERE.read_text().partition('MESSAGES = """')
    WHERE.write_text(f'{head}MESSAGES = """\\\n{definitions()}\n"""\n')
