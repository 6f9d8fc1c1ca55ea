"""What all rooms stand on: poses, clocks, errors, files, processes, XML, the C libraries."""
