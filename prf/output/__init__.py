"""What leaves a run: files for other programs, pictures, reports."""
