"""The demonstration: simulated drives of one route through the real nodes."""
