"""Scan against scan: where a query was taken, seen from the scan of a place (`align`)."""
