"""A user's own mesh, named parts or a skinned character, made into the body of an actor."""
