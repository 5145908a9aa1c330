"""A scenario flown a thousand times in drawn worlds."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.campaign.campaign import Campaign, Crew, run
    from sim.studies.campaign.crew import Cluster, Local, verify
    from sim.studies.campaign.draws import USUAL
    from sim.studies.campaign.folder import COLUMNS, CampaignRow, program_sha256
    from sim.studies.campaign.picture import plot, report, text

_MODULES = {
    "campaign": ("Campaign", "Crew", "run"),
    "crew": ("Cluster", "Local", "verify"),
    "draws": ("USUAL",),
    "folder": ("COLUMNS", "CampaignRow", "program_sha256"),
    "picture": ("plot", "report", "text"),
}


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, _MODULES, name)
