"""Field benchmark: default fits on records and plants that nobody tuned for."""
