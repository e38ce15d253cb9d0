"""The synthetic studio: a take of a moving body model, rendered to video with everything known."""
