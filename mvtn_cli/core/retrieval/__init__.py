"""Finding shapes by shapes: descriptors, distances, rankings and how good they are."""
