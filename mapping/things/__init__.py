"""Things without a name: what stands out of its surroundings and is no known object."""
