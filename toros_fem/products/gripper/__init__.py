"""A gripper whose fingers close on an object (Fig. 1)."""
