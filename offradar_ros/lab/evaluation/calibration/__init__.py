"""Which threshold on U keeps wrong answers as rare as wanted, and what is certain of it."""
