"""What a position and its stamp are: the same rules for tables, bags and live topics."""
