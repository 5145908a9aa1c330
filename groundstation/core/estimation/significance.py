"""Significance: standard deviations beyond which a deviation counts as evidence. Sans-IO."""

SIGNIFICANT = 4.0
"""Deviation that is no chance [standard deviations]: 6 in 100,000 normal draws lie beyond it."""
HIGHLY_SIGNIFICANT = 5.0
"""Deviation of a test that runs at every pose [standard deviations]: 6 in 10 million normal draws
lie beyond it."""
