"""What every part of the Python half needs: refusals, checks, files and geometry."""
