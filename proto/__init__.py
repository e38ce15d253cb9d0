"""The wire: messages, their framing, sockets and streams. Knows nothing of motion capture's maths."""
