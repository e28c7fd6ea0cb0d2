const uint TURNED = 1u << 31;  // beside the camera's number: the triangle's front was turned to it
