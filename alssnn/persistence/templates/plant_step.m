function x = plant_step(xu)
% Return the state one sample later, from [x; u].
model = plant_data();
n = model.lure.nx;
z = channels(model.lure, [xu(1:n); xu(n + 1:end) - model.u_offset]);
x = z(1:n);
end
