"""The parts of the pipeline between drivers and strategy, and how they are put together from a scene."""
