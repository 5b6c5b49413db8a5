function w = plant_control(w)
% Return [u; x; z], from [x; z; r; y; d]: one sample of the controller.
model = plant_data();
parts = mat2cell(w, [model.lure.nx, size(model.K_z, 2), $nr, $ny, $nd]);
[u, x, z] = control_alssnn(model, parts{:});
w = [u; x; z];
end
