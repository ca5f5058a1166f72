"""Campaigns of faults against the package: what is damaged, killed or sent, and what may come of it."""
