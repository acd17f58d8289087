"""The method 'recorrupted': a small network trained on recorrupted copies of one noisy mesh; see docs/method.md."""
