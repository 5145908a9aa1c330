"""A scenario flown a thousand times in drawn worlds."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from sim.studies.campaign.campaign import (
        COLUMNS,
        USUAL,
        Campaign,
        CampaignRow,
        Cluster,
        Crew,
        Local,
        plot,
        program_sha256,
        report,
        run,
        text,
        verify,
    )


def __getattr__(name: str) -> object:
    from links.core.lazy import load_name

    return load_name(__name__, name)
