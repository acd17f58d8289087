"""What leaves the program besides a mesh: pictures, animations, curves and a report, drawn without a window."""
