"""Metrics, one per file; they take plain arrays."""
