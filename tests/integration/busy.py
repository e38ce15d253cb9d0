"""Options of the search that give every worker something to do in every frame."""

BUSY = ("--set", 'search_limbs="always"')
