"""Training of learned encoders: cached scans, batches of places, objectives and the loop. Needs torch."""
