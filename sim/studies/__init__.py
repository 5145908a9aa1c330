"""Questions put to many flights: campaigns, comparisons, tuning, margins."""
