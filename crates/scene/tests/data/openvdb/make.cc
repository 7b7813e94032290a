// Makes the files beside it: g++ -O1 make.cc -lopenvdb -ltbb -lImath-3_1 && ./a.out (made with OpenVDB 10.0.1).
#include <openvdb/openvdb.h>

using namespace openvdb;

FloatGrid::Ptr make() {
    auto grid = FloatGrid::create(0.0f);
    grid->setName("density");
    auto values = grid->getAccessor();
    for (int i = 0; i < 12; i++)
        for (int j = 0; j < 9; j++)
            for (int k = 0; k < 10; k++)
                if ((i * 7 + j * 5 + k * 3) % 4 != 0) values.setValue(Coord(i + 1, j + 2, k + 3), 0.125f * i + 0.5f * j + 0.25f * k + 1.0f);
    // Not active, and not the background.
    values.setValueOff(Coord(3, 3, 4), 7.0f);
    values.setValueOff(Coord(3, 3, 5), 8.0f);
    // A tile of the size of a leaf.
    grid->fill(CoordBBox(Coord(16, 0, 8), Coord(23, 7, 15)), 0.75f, true);
    return grid;
}

int main() {
    initialize();
    auto grid = make();
    const math::Mat4d place(0.2, 0.1, 0.0, 0.0, -0.1, 0.2, 0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 1.0, 2.0, 3.0, 1.0);
    grid->setTransform(math::Transform::createLinearTransform(place));
    io::File("grid-blosc.vdb").write(GridPtrVec{grid});
    grid = make();
    grid->setSaveFloatAsHalf(true);
    grid->setTransform(math::Transform::createLinearTransform(0.5));
    io::File file("grid-half-zip.vdb");
    file.setCompression(io::COMPRESS_ZIP | io::COMPRESS_ACTIVE_MASK);
    file.write(GridPtrVec{grid});
}
