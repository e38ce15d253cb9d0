"""Bridge: turns poses into messages for animation tools."""
