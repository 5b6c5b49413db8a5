function y = plant_respond(xu)
#if FEEDS
% Return the outputs, from [x; u].
model = plant_data();
n = model.lure.nx;
z = channels(model.lure, [xu(1:n); xu(n + 1:end) - model.u_offset]);
#else
% Return the outputs, from x.
model = plant_data();
n = model.lure.nx;
z = channels(model.lure, [xu; zeros(size(model.u_offset))]);
#endif
y = z(n + (1:numel(model.y_offset))) + model.y_offset;
end
