"""What a run asks of its operating system: when a datagram arrived, real-time priority, cores, files written whole."""
