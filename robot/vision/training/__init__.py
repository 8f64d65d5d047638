"""Programs that make the weights of the detectors from labelled images; never needed at run time."""
