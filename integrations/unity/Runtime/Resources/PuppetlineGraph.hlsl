// Custom Function node for Shader Graph: type File, name PuppetlineBlend, inputs Position and Normal in object space, UV1,
// UV2 and UV3. Connect its outputs to Position and Normal of the Vertex stack. Graphs cannot read UV4 to 7, so the normals are
// the quick ones.

#ifndef PUPPETLINE_GRAPH_INCLUDED
#define PUPPETLINE_GRAPH_INCLUDED

#include "Puppetline.hlsl"

void PuppetlineBlend_float(
    float3 Position, float3 Normal, float4 UV1, float4 UV2, float4 UV3, out float3 BlendedPosition, out float3 BlendedNormal)
{
    PuppetlineRest rest;
    rest.position = Position;
    rest.normal = Normal;
    rest.block = 512 * (int)UV1.x;
    rest.isolines[0] = UV2;
    rest.isolines[1] = UV3;
    for (int i = 0; i < 4; i++)
    {
        rest.slopes[i] = float4(0, 0, 0, 0);
    }
    PuppetlinePoint blended = PuppetlineByCofactors(rest, PuppetlinePoseOf(rest, false));
    BlendedPosition = blended.position;
    BlendedNormal = blended.normal;
}

#endif
