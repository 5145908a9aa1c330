"""A recorded flight flown again, compared to the last bit."""
