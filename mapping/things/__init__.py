"""Things without a name: what stands out of the surface and is no known object."""
