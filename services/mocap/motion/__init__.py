"""Operations on the poses of many frames."""
