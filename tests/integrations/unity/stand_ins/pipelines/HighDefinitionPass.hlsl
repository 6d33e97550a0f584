// A stand-in: see ../README.md. A pass of HDRP, which is included after GetSurfaceAndBuiltinData.

PackedVaryingsToPS PassVertex(AttributesMesh mesh, float3 previousPositionOS)
{
    PackedVaryingsToPS output;
    output.positionCS = TransformWorldToHClip(TransformObjectToWorld(mesh.positionOS));
    output.normalWS = TransformObjectToWorldNormal(mesh.normalOS);
    output.tangentWS = mesh.tangentOS;
    output.texCoord0 = float4(mesh.uv0, 0, 0);
    output.color = mesh.color;
    output.previousPositionCS = mul(_PreviousObjectToWorld, float4(previousPositionOS, 1));
    return output;
}

#if SHADERPASS == SHADERPASS_MOTION_VECTORS
PackedVaryingsToPS Vert(AttributesMesh mesh, AttributesPass pass)
{
    float3 previous = unity_MotionVectorsParams.x > 0 ? pass.previousPositionOS : mesh.positionOS;
    return PassVertex(mesh, previous);
}
#else
PackedVaryingsToPS Vert(AttributesMesh mesh)
{
    return PassVertex(mesh, mesh.positionOS);
}
#endif

float4 Frag(PackedVaryingsToPS packed, bool front : SV_IsFrontFace) : SV_Target
{
    FragInputs input = (FragInputs)0;
    input.tangentToWorld[0] = packed.tangentWS.xyz;
    input.tangentToWorld[2] = packed.normalWS;
    input.texCoord0 = packed.texCoord0;
    input.color = packed.color;
    input.isFrontFace = front;
    PositionInputs place = (PositionInputs)0;
    SurfaceData surface;
    BuiltinData builtin;
    GetSurfaceAndBuiltinData(input, float3(0, 0, 1), place, surface, builtin);
    return float4(surface.baseColor * surface.normalWS.z + builtin.emissiveColor, builtin.opacity);
}
