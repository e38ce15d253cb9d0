"""Result files that other programs open, and the figures of a comparison with a reference."""
