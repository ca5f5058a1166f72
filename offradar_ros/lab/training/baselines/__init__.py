"""Objectives of the methods with which ours is compared, one per file."""
