"""Every column of a campaign's table: what the flight met, how it went, and what its certificate says."""

from sim.studies.campaign.folder import COLUMNS, Row
from sim.world.world import World
from tests.proving.reference.remarks import remarks

HEAD = """# Columns of a campaign

`groundstation-sim campaign --out FOLDER` writes `FOLDER/flights.csv`, a row a flight; what all flights share is in
`FOLDER/settings.json`. Where a flight crashed, or poses stayed away for too long, the figures that would mislead are
empty. `certificate_violated` and `certificate_suspended` are what `groundstation-sim fly` tells of the same flight, and
`groundstation fly` of a real one: V from measured quantities against its bound
([the law](../explanation/law.md), section 5.9). b̃ from the truth: only a simulation has it.

| column | |
|---|---|"""


def page() -> str:
    """The page."""
    said = remarks(World) | remarks(Row)
    return "\n".join([HEAD, *(f"| `{name}` | {said.get(name, '')} |" for name in COLUMNS)])
