"""A scenario flown a thousand times in drawn worlds."""

from sim.studies.campaign.campaign import (
    COLUMNS,
    USUAL,
    Campaign,
    CampaignRow,
    Cluster,
    Crew,
    Local,
    program_sha256,
    report,
    run,
    text,
)
