"""A scenario flown a thousand times in drawn worlds."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.campaign.campaign import Campaign, Crew, run
    from sim.studies.campaign.crew import Cluster, Local
    from sim.studies.campaign.draws import USUAL
    from sim.studies.campaign.folder import COLUMNS, Row, program_sha256
    from sim.studies.campaign.picture import plot
    from sim.studies.campaign.summary import report, text
    from sim.studies.campaign.verification import verify

_MODULES = {
    "campaign": ("Campaign", "Crew", "run"),
    "crew": ("Cluster", "Local"),
    "draws": ("USUAL",),
    "folder": ("COLUMNS", "Row", "program_sha256"),
    "picture": ("plot",),
    "summary": ("report", "text"),
    "verification": ("verify",),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
