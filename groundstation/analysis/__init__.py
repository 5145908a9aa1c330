"""What a recording tells: replay, report, identification."""
