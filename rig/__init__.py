"""The bench: everything that joins recognition to a rig, from the bench file to the command line."""
