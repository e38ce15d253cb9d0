"""Bridge: poses in, the messages out that animation tools listen to."""
