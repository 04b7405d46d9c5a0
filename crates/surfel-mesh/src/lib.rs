//! TSDF fusion of depth maps, marching cubes and mesh cleaning.
