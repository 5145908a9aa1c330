"""What prepares a laboratory and its vehicles: parameters, axes, propellers off, several vehicles."""
