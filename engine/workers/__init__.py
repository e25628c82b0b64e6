"""Engine processes that are started and followed: single jobs, and batches of folders on several workers."""
