"""Reports: what recordings say, as pictures, one HTML page, and numbers."""
