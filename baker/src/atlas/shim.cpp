// A C face over xatlas: segmentation and parametrisation only. The charts are read from xatlas' own structures right after
// ComputeCharts, because its public interface shows them only after its packer has moved and rescaled them.
// xatlas.cpp is compiled as it is, through this include; these macros are the ones it offers.
#define XA_MULTITHREADED 0
#define XA_DEBUG 0
#define XA_ASSERT(exp) ((void)0)
#define XA_DEBUG_ASSERT(exp) ((void)0)
#define XA_PRINT(...) ((void)0)
#define XA_PRINT_WARNING(...) ((void)0)
#include "xatlas.cpp"

#include <new>
#include <stdlib.h>

namespace {

void *realloc_or_throw(void *p, size_t size)
{
    void *q = realloc(p, size);
    if (!q && size > 0)
        throw std::bad_alloc();
    return q;
}

} // namespace

// Unwraps one mesh. positions and normals: xyz per vertex; indices: three per face, all below vertex_count.
// Writes u, v per face corner to uvs and a chart per face to charts (UINT32_MAX: xatlas left the face out).
// Returns the number of charts, or -1 when xatlas failed.
extern "C" int32_t baker_xatlas_unwrap(
    const float *positions, const float *normals, uint32_t vertex_count,
    const uint32_t *indices, uint32_t face_count,
    float *uvs, uint32_t *charts)
{
    try {
        static const bool allocator_set = (xatlas::SetAlloc(realloc_or_throw, free), true);
        (void)allocator_set;
        for (uint32_t f = 0; f < face_count; f++)
            charts[f] = UINT32_MAX;

        struct Owner
        {
            xatlas::Atlas *atlas = xatlas::Create();
            ~Owner() { xatlas::Destroy(atlas); }
        } owner;

        xatlas::MeshDecl decl;
        decl.vertexPositionData = positions;
        decl.vertexPositionStride = 3 * sizeof(float);
        decl.vertexNormalData = normals;
        decl.vertexNormalStride = 3 * sizeof(float);
        decl.vertexCount = vertex_count;
        decl.indexData = indices;
        decl.indexCount = 3 * face_count;
        decl.indexFormat = xatlas::IndexFormat::UInt32;
        if (xatlas::AddMesh(owner.atlas, decl, 1) != xatlas::AddMeshError::Success)
            return -1;

        xatlas::ChartOptions options;
        // Growing costs more than by default: half as many charts, of which the bad ones fall to the checks after.
        options.maxCost = 8.0f;
        xatlas::ComputeCharts(owner.atlas, options);

        const xatlas::internal::param::Atlas &computed = ((xatlas::Context *)owner.atlas)->paramAtlas;
        if (!computed.chartsComputed())
            return -1;
        int32_t chart_count = 0;
        for (uint32_t g = 0; g < computed.chartGroupCount(0); g++) {
            const xatlas::internal::param::ChartGroup *group = computed.chartGroupAt(0, g);
            for (uint32_t c = 0; c < group->chartCount(); c++, chart_count++) {
                const xatlas::internal::param::Chart *chart = group->chartAt(c);
                const xatlas::internal::Mesh *mesh = chart->unifiedMesh();
                for (uint32_t f = 0; f < mesh->faceCount(); f++) {
                    const uint32_t face = chart->mapFaceToSourceFace(f);
                    if (face >= face_count)
                        return -1;
                    charts[face] = (uint32_t)chart_count;
                    for (uint32_t i = 0; i < 3; i++) {
                        const xatlas::internal::Vector2 &uv = mesh->texcoord(mesh->vertexAt(f * 3 + i));
                        uvs[face * 6 + i * 2 + 0] = uv.x;
                        uvs[face * 6 + i * 2 + 1] = uv.y;
                    }
                }
            }
        }
        return chart_count;
    } catch (...) {
        return -1;
    }
}
