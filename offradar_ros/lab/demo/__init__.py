"""The demonstration: simulated drives on one route, replayed through the nodes."""
