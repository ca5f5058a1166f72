"""The model card of weights."""
