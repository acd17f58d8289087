"""Clean meshes made by formulas: the samples that come with the program, and shapes for development and tests."""
