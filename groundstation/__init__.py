"""The ground station: poses in, nonlinear adaptive control, thrust and body rates out."""
